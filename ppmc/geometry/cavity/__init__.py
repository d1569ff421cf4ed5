"""The space that tools leave free, and how a charge fills it."""
