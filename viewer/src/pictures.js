// The picture of the frame at hand with what is seen in it, as LBA09 figure 1 has it; only where somebody serves pictures.
export class Pictures {
  constructor(element, data) {
    this.element = element;
    this.canvas = document.createElement("canvas");
    this.canvas.hidden = true;
    this.note = document.createElement("output");
    this.note.id = "picture-note";
    element.append(this.canvas, this.note);
    this.camera = 0;
    this.shown = true;
    if (data.pictures > 1) this.chooser(data);
  }

  chooser(data) {
    const select = document.createElement("select");
    select.id = "picture-camera";
    for (let c = 0; c < data.pictures; ++c) select.append(new Option(data.cameras[c]?.name || `camera ${c}`, c));
    select.onchange = () => ((this.camera = Number(select.value)), this.want(this.frame));
    this.element.append(select);
  }

  // One request at a time: while it is under way only the newest wish is kept.
  async want(frame) {
    this.frame = frame;
    this.element.hidden = !this.shown;
    if (this.busy || !this.shown || frame === undefined) return;
    this.busy = true;
    for (let got = null; got !== this.key() && this.shown; ) {
      got = this.key();
      await this.fetch(this.frame, this.camera).catch(() => this.say("no picture"));
    }
    this.busy = false;
  }

  // There are none any more.
  end() {
    this.shown = false;
    this.element.hidden = true;
  }

  key() {
    return `${this.frame} ${this.camera}`;
  }

  say(text) {
    this.note.textContent = text;
    this.canvas.hidden = true;
  }

  async fetch(frame, camera) {
    const where = `?frame=${frame}&camera=${camera}`;
    const [picture, features] = await Promise.all([fetch(`picture${where}`), fetch(`features${where}`)]);
    if (!picture.ok) return this.say(await picture.text());
    const bitmap = await createImageBitmap(await picture.blob());
    this.draw(frame, bitmap, features.ok ? await features.json() : { size: [bitmap.width, bitmap.height], tracks: [], seen: 0 });
    bitmap.close();
  }

  // A line from where a point was in the frames before to where it is; discs where it was matched, rings where it is only expected.
  draw(frame, bitmap, { size = [0, 0], tracks = [], seen = 0, note }) {
    const { canvas } = this, context = canvas.getContext("2d");
    canvas.hidden = false;
    [canvas.width, canvas.height] = [bitmap.width, bitmap.height];
    context.drawImage(bitmap, 0, 0);
    const scale = bitmap.width / (size[0] || bitmap.width), at = (v) => (v + 0.5) * scale, radius = Math.max(1.5, bitmap.width / 260);
    context.lineWidth = Math.max(1, bitmap.width / 480);
    context.strokeStyle = "#ffd43bcc";
    context.beginPath();
    for (const track of tracks) {
      for (let k = 0; k < track.length; k += 2) context[k ? "lineTo" : "moveTo"](at(track[k]), at(track[k + 1]));
    }
    context.stroke();
    tracks.forEach((track, k) => {
      context.beginPath();
      context.arc(at(track[0]), at(track[1]), radius, 0, 2 * Math.PI);
      context.fillStyle = context.strokeStyle = k < seen ? "#40e06a" : "#4dabf7";
      if (k < seen) context.fill();
      else context.stroke();
    });
    this.tracks = tracks.length;
    const words = seen > 0 ? `${seen} points matched in this key frame` : `${tracks.length} points of the map in sight`;
    this.note.textContent = note ?? `frame ${frame}${tracks.length ? `: ${words}` : ""}`;
  }
}
