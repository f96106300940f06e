"""Scene to matrices, once per scene: stiffness, loads, joint operators."""
