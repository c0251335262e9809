"""A bridge between the Orchard and fleet control: carriers as vehicles of VDA 5050, over MQTT."""
