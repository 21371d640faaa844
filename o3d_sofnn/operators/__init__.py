"""The two operators, for any kind of cloud, and a replacement for Open3D's Poisson function."""
