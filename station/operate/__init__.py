"""Running robots: start, watch and stop dockings, switch LEDs and lock, move by hand."""
