"""One step: contact, velocities, time integration."""
