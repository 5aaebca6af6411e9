// A pennant: 40 cm along its top, 50 cm down to its tip. Lengths are in metres.
DefineConstant[ h = {0.03, Min 0.002, Max 0.2, Name "Parameters/h"} ];   // edge length, from the scene
Point(1) = {0, 0, 0, h};
Point(2) = {0.4, 0, 0, h};
Point(3) = {0.2, -0.5, 0, h};
Line(1) = {1, 2};
Line(2) = {2, 3};
Line(3) = {3, 1};
Curve Loop(1) = {1, 2, 3};
Plane Surface(1) = {1};
Physical Surface("cloth") = {1};
Physical Curve("top") = {1};       // names for [[pins]] and [[probes]]
Physical Point("tip") = {3};
