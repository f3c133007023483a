"""The same types as measured data, made with a known truth and labelled simulated."""
