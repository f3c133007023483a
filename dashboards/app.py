"""What `panel serve dashboards/app.py --setup dashboards/guard.py --address 127.0.0.1` serves."""

from dashboards.frame import serve_page

serve_page()
