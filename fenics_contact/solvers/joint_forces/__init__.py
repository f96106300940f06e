"""States with given friction by their joint forces: the way of Mihai and Ainsworth (2010)."""
