"""What the user describes: materials, joint laws, loads, options."""
