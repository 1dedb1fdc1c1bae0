"""The characters that random texts are made of."""

from hypothesis import strategies as st

# Those of ``st.text()``, which asks the codec of a million characters by itself: 3 s in a fresh clone.
ANY_CHARACTER = st.characters(exclude_categories=("Cs",))
