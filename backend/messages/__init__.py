"""What service and page say to each other, by subject: pydantic models that know no HTTP."""
