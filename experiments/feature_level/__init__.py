"""The paper's tables and figures on features instead of pixels, and its baselines."""
