"""Cameras, photos, rays and rotations: the geometry every other room shares."""
