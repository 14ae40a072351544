"""Recalibrate a camera-projector rig from one picture."""
