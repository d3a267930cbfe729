"""The training of an enhancement network: training.py with the loss of loss.py and the settings of config.py. data.py
names the sources; pairs.py draws rain on photographs; pair_folders.py reads published pairs."""
