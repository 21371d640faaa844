"""The two operators, for any kind of cloud, and what stands for Open3D's Poisson."""
