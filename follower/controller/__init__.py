"""DockingState → Command: the default method, and what methods share."""
