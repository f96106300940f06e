"""What a load factor owes to the mesh: hinges, the degree of displacements, refinement."""
