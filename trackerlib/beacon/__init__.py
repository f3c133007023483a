"""Where a beacon is, from the times at which one moving hydrophone heard it."""
