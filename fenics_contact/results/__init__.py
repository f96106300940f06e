"""What was found, as data: states, their verification, bounds, records, errors."""
