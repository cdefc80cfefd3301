"""The search for each method's gains: the same for all, on starts and disturbances that no table reports."""
