// Disk of radius 0.5 m about the origin; its centre is a node, for measuring deflections.
DefineConstant[ h = {0.05, Min 0.0005, Max 0.5, Name "Parameters/h"} ];
a = 0.5;
Point(1) = {0, 0, 0, h};
Point(2) = {a, 0, 0, h};
Point(3) = {0, a, 0, h};
Point(4) = {-a, 0, 0, h};
Point(5) = {0, -a, 0, h};
Circle(1) = {2, 1, 3};
Circle(2) = {3, 1, 4};
Circle(3) = {4, 1, 5};
Circle(4) = {5, 1, 2};
Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1};
Point{1} In Surface{1};
Physical Curve("rim") = {1, 2, 3, 4};
Physical Point("centre") = {1};
Physical Surface("sheet") = {1};
