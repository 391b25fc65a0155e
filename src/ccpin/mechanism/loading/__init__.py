"""From a file or a description to a Mechanism: loops closed, joints locked, motions counted (`loader`, `analysis`)."""
