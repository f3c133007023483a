"""A beacon fix in the formats that chart plotters, globes, spreadsheets and archives read."""
