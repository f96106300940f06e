"""What a structure of rigid blocks carries after the peak, in large displacements."""
