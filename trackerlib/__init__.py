"""From timed acoustic and radio signals to tracks, fixes and honest error figures.

Rooms, and who may lean on whom (left to right only):

    textfiles, compiled, frames, positions, rounding, residuals     on numpy, numba, pyproj alone
    acoustics                sound-speed profiles, rays, absorption, noise of the sea
    receiver                 from sound to marks on paper; what the receiver says on its line
    crossover, beacon        matched tracks of two arrays; a beacon's fix
    timing                   offset and drift, on crossover and acoustics
    rangefiles, surveyfiles  files in and out, of whatever type they build
    live                     what comes in over wires while it happens: lines, raw logs, the SAIL host, session files
    exports                  a fix as files of plotters, globes, spreadsheets, archives
    simulation               the same types with known truth; reads no files, writes a study's and a hunt's
    commands                 the shell's way in: one command, one file

`dashboards` leans on all of this and nothing here leans on `dashboards`.
"""

__version__ = "0.1.0"
