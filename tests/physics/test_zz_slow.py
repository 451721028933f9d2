from test_truncation import *
def test_it(tmp_path, frames):
    for m in (1,2,3):
        print(m, [told(tmp_path, frames(m), COURSES[c], 400)[1] for c in ("a blow","slow")])
