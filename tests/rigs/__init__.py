"""What tests of several folders share: rigs, walks, and the judge of the host."""
