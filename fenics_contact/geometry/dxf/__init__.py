"""DXF drawings: curves by layer, what layers mean, faces between lines, meshes, pictures."""
