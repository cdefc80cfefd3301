"""How the Follower moves, how far its wheels went, and where the Leader must be without sight."""
