"""Where particles of a charge lie: boxes, extrusions, closed surfaces, draped sheets."""
