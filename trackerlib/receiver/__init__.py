"""From sound to marks on paper."""
