// A field for a text that both the user and the program write: see typed_field.py.
export default {
  template: `<q-input :model-value="text" @update:model-value="type" />`,
  props: {
    // Of the element. Declared, so that Quasar gives the field an id of its own.
    id: String,
    // What the program wrote last, and how often it has written.
    written: String,
    writings: Number,
    // How often the user had typed, as far as the program knew when it wrote.
    heard: Number,
  },
  emits: ["typed"],
  data() {
    return { text: this.written, typings: this.heard };
  },
  beforeUnmount() {
    // The page may draw the field anew, which then goes on from here.
    const element = mounted_app.elements[this.id.slice(1)];
    if (element) Object.assign(element.props, { written: this.text, heard: this.typings });
  },
  watch: {
    writings() {
      // What was typed since is on its way to the program, which will take it.
      if (this.heard === this.typings) this.text = this.written;
    },
  },
  methods: {
    type(text) {
      this.text = text ?? "";
      this.typings += 1;
      this.$emit("typed", this.text, this.typings);
    },
  },
};
