/** What an experiment that was made of a run does not repeat. */

import page from "../Page.module.css";

export function LeftOut({ of }: { of: readonly string[] }) {
  if (of.length === 0) return null;
  return (
    <div className={page.dim}>
      Left out of the run:
      <ul aria-label="Left out of the run" style={{ margin: 0, paddingLeft: 20 }}>
        {of.map((text) => (
          <li key={text}>{text}</li>
        ))}
      </ul>
    </div>
  );
}
