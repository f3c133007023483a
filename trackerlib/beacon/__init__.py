"""Where a beacon is, from the times at which one moving hydrophone heard it.

`fix.fix_beacon(pings, settings)` gives a `BeaconFix`; `live.LiveFix` takes pings one at a time. Where to look:

    what goes in       pings, settings, motion, navigation (arrivals and a stream of positions)
    what comes out     result, convergence
    every ping         fix, attempt, search, minimise; paths, clock, folds
    free of ship bias  unbiased, squared_range, squared_sums, neighbours, bent
    the thesis's way   fix_pairs, pairs, pair_descent, pair_sums, objectives
    how sure           uncertainty, intervals, error_budget, diagnosis, choice, first_order
    refusals, advice   objections, observability, on_a_line, above_below, advice, planning
    while it happens   live, live_sums, live_survey
    bearing lines      bearing_lines (of closest approaches read off the chart)
    linear algebra     small_systems
"""
