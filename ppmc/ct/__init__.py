"""CT stage: fibre directions and platelet normals of a grey-value volume, and the phantom that tests them."""
