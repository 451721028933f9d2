/* Lets the search run where browsers allow no workers: on pages opened from the disk. There a frame takes the worker's
 * place; it runs the same script, and messages go to and fro as they would. */
(() => {
  if (location.protocol !== "file:") return;

  const message = (data) => new MessageEvent("message", { data });

  class FrameWorker extends EventTarget {
    constructor(url) {
      super();
      this.onmessage = null;
      this.frame = document.createElement("iframe");
      this.frame.hidden = true;
      document.body.append(this.frame);
      const inner = this.frame.contentWindow;
      inner.postMessage = (data) => {
        this.dispatchEvent(message(data));
        if (this.onmessage) this.onmessage(message(data));
      };
      const base = new URL(url, location.href);
      const load = (address) =>
        new Promise((resolve, reject) => {
          const script = this.frame.contentDocument.createElement("script");
          Object.assign(script, { src: new URL(address, base), onload: resolve, onerror: reject, async: false });
          this.frame.contentDocument.body.append(script);
        });
      inner.importScripts = (...addresses) => Promise.all(addresses.map(load));
      this.ready = load(base);
    }

    postMessage(data) {
      this.ready.then(() => this.frame.contentWindow.dispatchEvent(message(data)));
    }

    terminate() {
      this.frame.remove();
    }
  }

  window.Worker = FrameWorker;
})();
