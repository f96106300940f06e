"""Rigid blocks and the forces of their faces: limit loads with a proved gap."""
