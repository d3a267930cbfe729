"""One run: a method on a variant with a seed.

    run.py                 where its files are, its settings and its data
    run_options.py         what evaluations and sweeps have in common
    train_and_render.py    its first half, in a process of its own
    supervision.py         such processes: what they may take, how they ended
    own_files.py           what a run writes into its folder, beside its method
    sessions.py            every start of its training
    probe.py               whether its method can be imported, tried first
    estimated_cameras.py   cameras of the track rainy-poses
    finished_runs.py       finished runs, opened again

Read `run.py` first.
"""
