"""DockingState → Command: prediction model, predictive control, disturbance compensation."""
