"""Linear programs of rigid blocks: bounds on load factors, and a check of the elastic ones."""
