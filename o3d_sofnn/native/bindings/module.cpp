// SPDX-License-Identifier: MIT
#include "bindings/arrays.hpp"

NB_MODULE(_kernels, m) {
  sofnn::bind_geometry(m);
  sofnn::bind_sampling(m);
  sofnn::bind_rules(m);
  sofnn::bind_orientation(m);
  sofnn::bind_implicit(m);
  sofnn::bind_meshing(m);
}
