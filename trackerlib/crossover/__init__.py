"""Two arrays' versions of one track: gating, pairs, straight lines, noise."""
