"""Contact by joint torque: contacts recognised, and no false ones over pads and bumps."""
