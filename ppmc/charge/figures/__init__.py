"""Pictures of a charge."""
