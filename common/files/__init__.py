"""Files that outlive a process: written beside the loop, and read although anything may be in them."""
