"""Limit loads over values of a scene's keys."""
