"""Watch a flight in a browser. The pages are NiceGUI's, drawn by `board.vue`, which `board.css` styles."""
