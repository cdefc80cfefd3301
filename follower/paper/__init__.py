"""The paper's own method: homography, extended state observer, NMPC, compensation."""
