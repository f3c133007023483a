"""Timing offset and drift of a track, through the rays that carried it."""
