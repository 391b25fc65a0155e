"""What the formats share: XML, meshes, graphs of joints and the trees in them, hinges, and what a format leaves out."""
