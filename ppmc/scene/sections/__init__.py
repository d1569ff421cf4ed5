"""The sections of a scene, a file each."""
