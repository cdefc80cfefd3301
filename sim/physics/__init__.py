"""What moves and touches in the simulated world: base, arms, trolleys, queue, guide and lock."""
