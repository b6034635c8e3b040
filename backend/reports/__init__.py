"""Reports as HTML and PDF, and exports of samples."""
