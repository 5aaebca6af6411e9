// Front panel of a shirt: body 0.5 m wide and 0.7 m high, sleeves out to 0.4 m from the middle,
// and a round neck hole of radius 0.07 m. The hem is at the bottom, a cuff at each sleeve's end.
DefineConstant[ h = {0.03, Min 0.0005, Max 0.1, Name "Parameters/h"} ];
body = 0.25;
reach = 0.4;
armpit = 0.48;
top = 0.7;
neck = 0.07;
neck_y = 0.59;
Point(1) = {-body, 0, 0, h};
Point(2) = {body, 0, 0, h};
Point(3) = {body, armpit, 0, h};
Point(4) = {reach, armpit, 0, h};
Point(5) = {reach, top, 0, h};
Point(6) = {-reach, top, 0, h};
Point(7) = {-reach, armpit, 0, h};
Point(8) = {-body, armpit, 0, h};
For i In {1:8}
  Line(i) = {i, (i % 8) + 1};
EndFor
Point(20) = {0, neck_y, 0, h};
Point(21) = {neck, neck_y, 0, h};
Point(22) = {0, neck_y + neck, 0, h};
Point(23) = {-neck, neck_y, 0, h};
Point(24) = {0, neck_y - neck, 0, h};
Circle(21) = {21, 20, 22};
Circle(22) = {22, 20, 23};
Circle(23) = {23, 20, 24};
Circle(24) = {24, 20, 21};
Curve Loop(1) = {1:8};
Curve Loop(2) = {21:24};
Plane Surface(1) = {1, 2};
Physical Curve("hem") = {1};
Physical Curve("cuffs") = {4, 6};
Physical Curve("neck") = {21:24};
Physical Curve("shoulders") = {5};
Physical Surface("sheet") = {1};
