"""Generated 3D scenes as labelled meshes: rooms, objects, streets, and walls for calibration."""
