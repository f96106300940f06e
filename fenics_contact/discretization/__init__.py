"""What the user described, as matrices: mesh in, stiffness, loads and joint operators out, once per scene."""
