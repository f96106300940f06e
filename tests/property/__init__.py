"""Properties that hold for every scene, over random scenes."""
