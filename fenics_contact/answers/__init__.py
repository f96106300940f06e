"""What is known of a collapse beside its load factor: a file for each kind of answer."""
