Point(1) = {0, 0, 0, 1}; Point(2) = {1, 0, 0, 1}; Point(3) = {0.5, 0.8660254037844386, 0, 1};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 1};
Curve Loop(1) = {1, 2, 3}; Plane Surface(1) = {1};
Transfinite Curve {1, 2, 3} = 2;
Physical Curve("base") = {1}; Physical Point("apex") = {3}; Physical Surface("sheet") = {1};
