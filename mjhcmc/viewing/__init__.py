"""Looking at solutions: in MuJoCo's viewer, in the browser, as a video. Nothing here is imported before it is used."""
