"""What the estimator sees in hard light: locks, losses, wrong LEDs, errors beside their bound."""
