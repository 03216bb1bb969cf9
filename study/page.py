"""stub"""
def write_page(): pass
