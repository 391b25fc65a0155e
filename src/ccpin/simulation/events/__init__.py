"""What is recorded of a motion at an instant, and what is watched for along it: zeros, settling, surfaces, regions."""
