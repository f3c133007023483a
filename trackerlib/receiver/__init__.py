"""From sound to marks on paper, and what the thesis's receiver says on its line.

`detectors.hear` gives the arrivals of either detector in a stream of sound, block by block. Where to look:

    recordings          recording, recording_start
    the report's chain  report_receiver, carrier, front_end, front_end_design, maxima, level_curve
    matched filter      matched, cells, demodulation, detection_curve
    either of them      detectors, arrivals
    a pinger's train    trains, intervals, chains, multiples, echoes, late_echoes, following
    its serial line     sail, periods
    the paper           chart, rolls, hyperbola
"""
