"""Files of a tracking range, in feet: T-files, array surveys, crossover sets, VELOCITY.DAT, MMATRIX.M."""
