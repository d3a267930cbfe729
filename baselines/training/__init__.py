"""What every training needs: a loop, checkpoints, devices, the training photographs."""
