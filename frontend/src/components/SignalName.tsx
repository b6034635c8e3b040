/** A signal's name as it is written in the paper: q_ref with a lowered "ref". */

export function SignalName({ name }: { name: string }) {
  const [letter, ...index] = name.split("_");
  return (
    <span className="symbol">
      <i>{letter}</i>
      {index.length > 0 && <sub>{index.join(",")}</sub>}
    </span>
  );
}
