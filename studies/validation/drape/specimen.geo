// The specimen of the drape test of JIS L 1096: radius 127 mm, over a support of radius 63.5 mm.
DefineConstant[ h = {0.012, Min 0.001, Max 0.1, Name "Parameters/h"} ];
a = 0.127;
b = 0.0635;
Point(1) = {0, 0, 0, h};
For i In {0:3}
  Point(2 + i) = {b * Cos(i * Pi / 2), b * Sin(i * Pi / 2), 0, h};
  Point(12 + i) = {a * Cos(i * Pi / 2), a * Sin(i * Pi / 2), 0, h};
EndFor
For i In {0:3}
  Circle(1 + i) = {2 + i, 1, 2 + (i + 1) % 4};
  Circle(11 + i) = {12 + i, 1, 12 + (i + 1) % 4};
EndFor
Curve Loop(1) = {1:4};
Curve Loop(2) = {11:14};
Plane Surface(1) = {1};
Plane Surface(2) = {2, 1};
Physical Surface("support") = {1};
Physical Surface("overhang") = {2};
Physical Curve("rim") = {11:14};
