"""Results in, Bokeh figures out: one class a picture, updated by replacing the columns that changed."""
