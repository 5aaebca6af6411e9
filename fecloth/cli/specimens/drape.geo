// The hanging ring of Cusick's drape test, 0.3 m wide, around its support, 0.18 m wide.
DefineConstant[ h = {0.006, Min 0.0005, Max 0.1, Name "Parameters/h"} ];
a = 0.15;
b = 0.09;
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
Plane Surface(1) = {2, 1};
Physical Surface("overhang") = {1};
Physical Curve("support") = {1:4};
Physical Curve("rim") = {11:14};
