"""What has nothing to do with arms: arguments, files, extras, progress, interrupts, errors."""
