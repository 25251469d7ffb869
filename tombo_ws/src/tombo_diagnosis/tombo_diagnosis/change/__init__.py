"""What has changed on a vehicle: new flights against its own healthy ones."""
