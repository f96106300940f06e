"""What a limit load is: how collapse states are found, bounded and verified."""
