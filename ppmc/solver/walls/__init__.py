"""Tools as the particles meet them: contact, friction, motion."""
