"""The Panel app: it arranges, calls one function of `trackerlib`, draws one result."""
