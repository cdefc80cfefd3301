"""Real processes under load: what gives, in which order, and whether it gives safely."""
