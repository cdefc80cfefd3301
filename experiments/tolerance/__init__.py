"""What small errors of the geometry cost at the dock, with each way to learn of them."""
