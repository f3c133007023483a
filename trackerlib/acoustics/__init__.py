"""Sound in water: speed profiles and the rays that follow from them."""
