"""Camera, lens, mounting and taught images: what an engineer measures before the first docking."""
