"""Contact by joint torque: true contacts found, pads and bumps not taken for one."""
