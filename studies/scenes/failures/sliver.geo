// A square with a point near its edge: a triangle 1 cm high among those of 10 cm.
Point(1) = {0, 0, 0, 0.1};
Point(2) = {1, 0, 0, 0.1};
Point(3) = {1, 1, 0, 0.1};
Point(4) = {0, 1, 0, 0.1};
Point(5) = {0.55, 0.01, 0, 0.1};
Line(1) = {1, 2};
Line(2) = {2, 3};
Line(3) = {3, 4};
Line(4) = {4, 1};
Transfinite Curve {1, 2, 3, 4} = 11;
Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1};
Point {5} In Surface {1};
Physical Curve("left") = {4};
Physical Surface("sheet") = {1};
