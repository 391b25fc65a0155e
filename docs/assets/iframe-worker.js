// The search's worker in a frame of the page where the site is opened as files: browsers start no worker from those.
if (location.protocol === "file:")
  window.Worker = class {
    constructor(url) {
      this.frame = Object.assign(document.createElement("iframe"), { hidden: true, title: "search" });
      document.body.append(this.frame);
      const { contentWindow: inside, contentDocument: page } = this.frame;
      inside.postMessage = data => setTimeout(() => this.onmessage?.({ data }));
      const script = Object.assign(page.createElement("script"), { src: new URL(url, document.baseURI) });
      this.inside = new Promise((done, failed) => { script.onload = () => done(inside); script.onerror = failed; });
      page.body.append(script);
    }
    postMessage(data) { this.inside.then(inside => inside.onmessage({ data })); }
    terminate() { this.frame.remove(); }
  };
