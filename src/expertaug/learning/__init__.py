"""Training, augmentation and fine-tuning of groups of seeds."""
