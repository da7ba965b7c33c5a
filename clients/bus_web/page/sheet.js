// The details beside the bus. In a narrow window they are a sheet over its lower part while something is chosen.

const NARROW = matchMedia("(max-width: 900px)"); // as in style.css

export class Sheet {
  // `close()` when the user presses Escape while something is chosen.
  constructor(root, close) {
    this.root = root;
    this.isOpen = false;
    this.openers = []; // elements that may get the focus when it closes, the first that still exists
    this.below = null; // an element that must not be below the sheet
    document.addEventListener("keydown", (event) => {
      if (event.key === "Escape" && this.isOpen && !event.target.closest("input, select")) close();
    });
    new ResizeObserver(() => this.makeRoom()).observe(root);
    NARROW.addEventListener("change", () => this.makeRoom());
  }

  get hasFocus() {
    return this.root.contains(document.activeElement);
  }

  // After a choice. `hadFocus`: whether the user made it in the sheet. `row`: where the choice is in the table.
  open(hadFocus, row) {
    this.isOpen = true;
    this.root.classList.add("open");
    this.makeRoom();
    if (!hadFocus) this.openers = [document.activeElement, row].filter((one) => one && one !== document.body);
    if (!hadFocus && !NARROW.matches) return;
    this.root.querySelector("h2").focus({ preventScroll: true });
    this.root.scrollTop = 0;
    this.below = hadFocus ? null : this.openers[0] ?? null;
  }

  // After everything was drawn.
  settle() {
    const below = this.below;
    this.below = null;
    if (!below) return;
    const { top, bottom } = below.getBoundingClientRect();
    const around = below.closest(".scroll, .graph")?.getBoundingClientRect() ?? { top: 0, bottom: Infinity };
    const isSeen = top >= Math.max(0, around.top) && bottom <= Math.min(this.root.getBoundingClientRect().top, around.bottom);
    if (!isSeen) below.scrollIntoView({ block: "center", inline: "nearest" });
  }

  shut(hadFocus) {
    this.isOpen = false;
    this.root.classList.remove("open");
    this.makeRoom();
    if (hadFocus) this.openers.find((one) => one.isConnected)?.focus();
  }

  // The sheet hides nothing for good: the page below can be scrolled so far, and is for an element with the focus.
  makeRoom() {
    const height = NARROW.matches && this.isOpen ? this.root.offsetHeight : 0;
    document.documentElement.style.setProperty("--sheet", `${height}px`);
  }
}
