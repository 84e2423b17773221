"""The app: a local server and its pages in the browser, on the files and commands of the command line."""
