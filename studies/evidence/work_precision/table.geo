// A square tablecloth, 0.24 m wide, without the part on its round table, 0.1 m wide.
DefineConstant[ h = {0.01, Min 0.0005, Max 0.1, Name "Parameters/h"} ];
a = 0.12;
b = 0.05;
Point(1) = {0, 0, 0, h};
For i In {0:3}
  Point(2 + i) = {b * Cos(i * Pi / 2), b * Sin(i * Pi / 2), 0, h};
  Point(12 + i) = {a * Sqrt(2) * Cos((i + 0.5) * Pi / 2), a * Sqrt(2) * Sin((i + 0.5) * Pi / 2), 0, h};
EndFor
For i In {0:3}
  Circle(1 + i) = {2 + i, 1, 2 + (i + 1) % 4};
  Line(11 + i) = {12 + i, 12 + (i + 1) % 4};
EndFor
Curve Loop(1) = {1:4};
Curve Loop(2) = {11:14};
Plane Surface(1) = {2, 1};
Physical Surface("overhang") = {1};
Physical Curve("edge") = {1:4};
