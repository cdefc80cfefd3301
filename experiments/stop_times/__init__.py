"""How soon the wheels stop after a process dies or hangs: real processes on a simulated bus."""
