export default function IdentifyPage() {
  return <h1>IdentifyPage</h1>;
}
