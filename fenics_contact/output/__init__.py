"""What people look at: fields, files, pictures."""
