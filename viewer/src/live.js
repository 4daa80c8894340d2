// A run that is under way: events from the server, and the map anew whenever there is a newer one.
export class Live {
  // `on.map(first, rest)`: what page_data.cpp wrote; `on.frames(live)`: newest frames; `on.state(text, over)`.
  constructor(on) {
    this.on = on;
    this.shown = 0; // revision of the map
    this.events = new EventSource("events");
    this.events.onmessage = (event) => this.hear(JSON.parse(event.data));
    this.events.onerror = () => this.on.state("the run cannot be reached", false);
  }

  hear(news) {
    this.news = news;
    this.on.frames(news);
    if (!news.over) this.on.state(news.state, false);
    else this.events.close();
    this.update();
  }

  // One request at a time; what became newest meanwhile is asked for next.
  async update() {
    if (this.busy) return;
    this.busy = true;
    try {
      while (this.news.map > this.shown) {
        const asked = this.news.map, answer = await fetch("data");
        if (!answer.ok) break;
        const texts = (await answer.text()).split("\n");
        this.shown = asked;
        this.on.map(...texts);
      }
    } catch {
      this.on.state("the run cannot be reached", false);
    }
    this.busy = false;
    if (this.news.over) this.on.state(this.news.state, true);
  }
}
