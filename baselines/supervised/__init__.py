"""Networks that are trained once, from pairs of pictures, and shipped: their training, their weights, their commands.

    training.py     the training: batches, rates, averaged weights, validation, a curve; read it first
    config.py       settings of every such training
    weights.py      trained networks on disk
    commands.py     the commands that train and export
    validation.py   how well a network does, by kind of picture

A network brings its loss (a `SupervisedTraining`), its pairs and its validation (a `TrainingRequest`).
"""
