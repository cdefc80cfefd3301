"""What tests of several packages share: rigs, walks, and the judge of the host."""
