// A plate 60 mm x 40 mm with a stiff round inclusion, notched from the left: gmsh -2 notched_part.geo
SetFactory("OpenCASCADE");
h = 0.7;
Rectangle(1) = {0, 0, 0, 60, 40};
Disk(2) = {36, 15, 0, 6, 6};
Point(100) = {0, 20, 0, h};
Point(101) = {18, 20, 0, h};
Line(100) = {100, 101};
BooleanFragments{ Surface{1, 2}; Delete; }{ Line{100}; Delete; }
Mesh.MeshSizeMin = h;
Mesh.MeshSizeMax = h;
e = 1e-3;
Physical Curve("slit") = Curve In BoundingBox{-e, 20 - e, -e, 18 + e, 20 + e, e};
Physical Curve("top") = Curve In BoundingBox{-e, 40 - e, -e, 60 + e, 40 + e, e};
Physical Curve("bottom") = Curve In BoundingBox{-e, -e, -e, 60 + e, e, e};
Physical Surface("inclusion") = {2};
Physical Surface("matrix") = {3};
